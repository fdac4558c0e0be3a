"""Parts that all importers share: options, the result of an import, coverage, names of pieces and polling periods."""
