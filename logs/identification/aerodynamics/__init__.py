"""Air loads of the wings and what their coefficients depend on."""
