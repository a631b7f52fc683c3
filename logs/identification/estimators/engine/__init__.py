"""The maximum-likelihood engine: Gauss-Newton with bounds and nuisance parameters per record."""
