"""Flight-path reconstruction (data compatibility check)."""
