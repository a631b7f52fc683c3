"""Several models of the same data, each counting as likely as the data makes it (Bayesian model averaging).

What is found by the likeliest of them alone promises too much where the data hardly tells which it is (Hoeting,
Madigan, Raftery & Volinsky, Bayesian Model Averaging: A Tutorial, Statistical Science 14(4), 1999).
"""

from __future__ import annotations

import numpy as np

from logs.identification.estimators.flight.equation_error import DerivativeFit
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread


def likely(evidences: Array, before: Array) -> Array:
    """Probabilities (k,) of models after the data, by Bayes (Hoeting et al. Eq. 2).

    ``evidences`` (k,) are logarithms of how likely the data is of each, minus infinity of one that found no optimum;
    not all are. ``before`` (k,) are the probabilities before the data.
    """
    logs = evidences + np.log(before)
    shares = np.exp(logs - np.max(logs))
    return np.asarray(shares / np.sum(shares), dtype=np.float64)


def mixed(fits: tuple[DerivativeFit, ...], shares: Array) -> DerivativeFit:
    """One fit of several of the same derivatives, weighed by ``shares`` (k,).

    Its values are the mean; what the fits differ by is among the errors (Hoeting et al. Eq. 3 and the variance below
    it).
    """
    likeliest = fits[int(np.argmax(shares))]
    values = np.einsum("k,kp->p", shares, [fit.values for fit in fits])
    apart = np.array([fit.values - values for fit in fits])
    among = np.einsum("k,kp,kq->pq", shares, apart, apart)
    betweens = [fit.spread.between for fit in fits]
    between = None
    if all(each is not None for each in betweens):
        between = np.einsum("k,kpq->pq", shares, np.array(betweens))
    spread = Spread(
        np.einsum("k,kpq->pq", shares, [fit.spread.covariance for fit in fits]),
        float(shares @ [fit.spread.degrees for fit in fits]),
        between,
        likeliest.spread.records,
    )
    scatter = np.einsum("k,km->m", shares, [fit.scatter for fit in fits])
    return likeliest._replace(values=values, spread=spread.plus(among), scatter=scatter)
