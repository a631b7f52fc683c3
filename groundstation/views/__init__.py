"""Views: flight view, terminal plots, reports."""
