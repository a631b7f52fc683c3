"""What is done to signals before a model is fitted: averaging, filtering, cutting, aligning."""
