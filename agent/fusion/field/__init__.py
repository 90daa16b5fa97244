"""The estimator ``field``: activity per area of contaminated ground, from counts."""
