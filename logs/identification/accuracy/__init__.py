"""How far numbers may be trusted: colour of residuals, correlation of parameters, whiteness, held-out prediction."""
