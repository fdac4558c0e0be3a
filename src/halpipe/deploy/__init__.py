"""Checks of bundles: do they do on their target what their schedule says? They share nothing with the exporters."""
