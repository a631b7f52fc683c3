"""What a person sees: the flight view, plots in the terminal, reports."""
