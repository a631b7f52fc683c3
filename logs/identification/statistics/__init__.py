"""Statistics of residuals and estimates: covariance, whiteness, correlation, Theil."""
