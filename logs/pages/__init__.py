"""HTML pages: one file each, without network access, printable on A4."""
