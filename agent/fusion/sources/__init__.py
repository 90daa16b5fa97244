"""The estimator ``sources``: number, nuclide, place and activity of sources at rest, from coarse spectra and cones.

Greedy search with continuous point sources, joint Fisher scoring, evidence by Laplace's method. Modules:

- ``spectra``, ``tables``: counts of a camera by nuclide, energy and distance;
- ``data``: the measurements;
- ``counts``, ``hidden``, ``directions``: the likelihoods of counts, of counts behind unknown walls, and of cones;
- ``solution``, ``fit``: the fitted sources and nuisances; their fit;
- ``candidates``, ``moves``: births, deaths and other moves of sources;
- ``unknown``: sources of nuclides that are not among the candidates;
- ``misled``: common errors of the model that the fit leaves out;
- ``hiding``: exclusion limits of further sources;
- ``estimator``, ``state``, ``telling``: when sources at rest are fitted; the state; the reported sources;
- ``handover``, ``tracker``: the estimator as a whole, also of a moving source.
"""
