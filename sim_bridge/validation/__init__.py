"""Published figures beside ours, computed when asked for; one file for each paper."""
