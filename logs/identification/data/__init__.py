"""Signals of experiments: segments, resampling, smoothing and differentiation."""
