"""Tuning of a loop: linear models, blocks, margins, search for gains."""
