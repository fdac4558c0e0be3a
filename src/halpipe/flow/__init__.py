"""What command line, API and server share: formats, pipeline files, and the stages between them in their order."""
