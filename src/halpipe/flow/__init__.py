"""Stages shared by command line, API and server: formats, pipeline files, and their order."""
