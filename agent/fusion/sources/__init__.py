"""The estimator ``sources``: number, nuclide, place and activity of sources at rest, from coarse spectra and cones.

Greedy search with continuous point sources, joint Fisher scoring, evidence by Laplace's method. Modules: what a camera counts of
a nuclide (``spectra``, ``tables``); the measurements (``data``); the likelihoods of counts (``counts``), also behind what nobody
knows of (``hidden``), and of cones (``directions``); the sources and nuisances that are fitted (``solution``); the fit (``fit``);
how sources come and go (``candidates``, ``moves``); those of nuclides that are no candidates (``unknown``); errors that the fit
does not know (``misled``); where more may hide (``hiding``); when sources at rest are fitted (``estimator``), from what
(``state``), and what is told of them (``telling``); the estimator as a whole, also of a source that moves (``handover``,
``tracker``).
"""
