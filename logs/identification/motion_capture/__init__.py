"""Vehicle motion from marker positions."""
