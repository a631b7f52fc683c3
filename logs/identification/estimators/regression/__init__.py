"""Equation error: regressors, designs and least squares."""
