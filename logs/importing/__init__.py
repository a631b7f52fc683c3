"""Importers of logs of other programs."""
