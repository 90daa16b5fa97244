"""The estimator ``bayes``: a recursive Bayesian estimator over cones and count rates, without random numbers.

Search: a point-mass filter on a grid of places and activities. Track: a Gaussian sum over position, velocity, activity and the
biases of the vehicles' poses.
"""
