"""Levels and sizes that tests, searches and iterations share. What a single one needs is stated with it."""

CHANCE = 3.0
"""Sigmas up to which a difference may be chance: one in 370 is larger."""
CONTRADICTION = 4.0
"""Sigmas beyond which two results contradict each other, or one violates a bound: one in 16,000 by chance."""
CERTAIN = 5.0
"""Sigmas beyond which nothing is chance, although thousands of values are compared: one in 1.7 million."""
MAIN_PART = 0.5
"""Part beyond which something is the main part of a misfit or of a log."""
ITERATIONS = 8
"""Most steps of a Gauss–Newton iteration. One that converges needs three to five."""
SLOW_ITERATIONS = 20
"""The same among unknowns that are nearly collinear, where steps are small."""
STILL = 0.1
"""Change in sigmas, or of −2 log likelihood, below which an iteration has converged."""
EVEN, UNUSUAL, CLEAR = 6.0, 9.2, 14.0
"""−2 log of odds: 1 : 20, up to which two causes are named side by side; 1 : 100, prior odds of what is seldom; and 1 : 1000, by which a
cause must beat its rivals to be named alone."""
FINALISTS = 3
"""Number of the best candidates that are examined further."""
ENOUGH = 30
"""Least number of values for a variance, which then has a relative sigma of a quarter."""
LONG = 4096
"""Cycles of a log that one fit uses at most. More would cost time and memory and hardly change its result."""
SHORT = 1200
"""Cycles of a log that are used where a fit is repeated for many hypotheses."""
BLOCK = 1024
"""Cycles that are processed together."""
PARTS = 32
"""Number of equal parts of a log that are compared."""
DIFFERENCE = 1e-4
"""Step of a difference quotient, over the natural size: rounding and the terms of higher order are alike."""
RESOLUTION = 1e-4
"""Residual over signal that is left without noise, since the motion within a cycle is modelled as linear."""
GROSS = 4.0
"""Mean squared residual over the noise variance beyond which a model is wrong, even if its noise levels are estimated."""
EDGE = 4
"""Cycles at an edge whose commands may act before or after it."""
SLIGHT = 0.02
"""Relative change of a thrust or of a body that is too small to count as one."""
KNOWN, UNINFORMED = 0.1, 0.3
"""Relative sigma below which a positive value counts as known, and above which a log does not inform it."""
