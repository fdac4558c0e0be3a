"""XML schemas, one per artefact."""
