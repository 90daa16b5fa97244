"""The estimator ``bayes``: a recursive Bayesian estimator of one gamma source from Compton cones and count rates.

The estimator draws no random numbers. While the source is not localised, a point-mass filter runs on a grid of places, activities
and motion modes (``search``). Once the posterior is narrow enough, a Gaussian sum of IMM filters takes over (``mixture``,
``motion``). Its state includes the pose biases of the vehicles. ``estimator`` decides between the two, and ``tracking`` updates
the sum. ``cones`` and ``counts`` hold the likelihoods, ``response`` the expected rates, and ``hidden`` unknown obstacles.
docs/estimator.md derives the whole.

Notation of the docstrings: P(..) probability, p(..) density, N(z; m, V) Gaussian density, ' transpose, ~ distributed as;
H1 a source is there, H0 none is. Sizes: S sites (components of the Gaussian sum), M motion modes, V vehicles, d = 5 + 4 V the
state's dimension, K readings of a cone, L levels of attenuation, C components of an exposure, A activity levels, B background
levels; of a grid, C cells. World frame: the mission frame (ENU), metres.

References
    [AS72] Alspach, Sorenson: Nonlinear Bayesian estimation using Gaussian sum approximations. IEEE Trans. Automatic Control 17
        (1972) 439-448.
    [BBS88] Blom, Bar-Shalom: The interacting multiple model algorithm for systems with Markovian switching coefficients. IEEE
        Trans. Automatic Control 33 (1988) 780-783.
    [BST75] Bar-Shalom, Tse: Tracking in a cluttered environment with probabilistic data association. Automatica 11 (1975)
        451-460.
    [BS71] Bucy, Senne: Digital synthesis of non-linear filters. Automatica 7 (1971) 287-298.
    [TK86] Tierney, Kadane: Accurate approximations for posterior moments and marginal densities. J. American Statistical
        Association 81 (1986) 82-86.
    [UO30] Uhlenbeck, Ornstein: On the theory of the Brownian motion. Physical Review 36 (1930) 823-841.
    [S70] Singer: Estimating optimal tracking filter performance for manned maneuvering targets. IEEE Trans. Aerospace and
        Electronic Systems 6 (1970) 473-483.
    [S90] Salmond: Mixture reduction algorithms for target tracking in clutter. Proc. SPIE 1305 (1990) 434-445.
    [R07] Runnalls: Kullback-Leibler approach to Gaussian mixture reduction. IEEE Trans. Aerospace and Electronic Systems 43
        (2007) 989-999.
    [R89] Rabiner: A tutorial on hidden Markov models and selected applications in speech recognition. Proceedings of the IEEE
        77 (1989) 257-286.
    [BSLK01] Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation. Wiley (2001).
"""
