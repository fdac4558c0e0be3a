"""The workbench: a model in the browser, edited in place; every answer is a schedule that has passed verify.

`edits` changes a model by one statement, `session` keeps the model with its schedule, history and variants, `picture`
says what a browser draws, and `server` is the door. Only the server knows of HTTP.
"""
