"""What the kinematics of a symmetric flight add to those of small motion, to second order.

``u' = f_x - w q - g sin(theta)``, ``w' = f_z + u q + g cos(theta)`` (Klein & Morelli, Aircraft System Identification,
2006, ch. 3): the linear model has the reference's u and w in the products and straight lines for sine and cosine. The
aerodynamic forces stay linear.
"""

from __future__ import annotations

import numpy as np

from logs.identification.data.maneuvers import Manoeuvre, Reference
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY


def turned(states: Array, manoeuvre: Manoeuvre, reference: Reference) -> Array:
    """Accelerations (N, 3) along x, along z and in pitch beyond the linear ones, of ``states`` (N, 4) about the
    reference."""
    u, w, q, pitch = _anchored(states, manoeuvre, reference).T
    sin, cos = np.sin(reference.pitch), np.cos(reference.pitch)
    along_x = -w * q - STANDARD_GRAVITY * (np.sin(reference.pitch + pitch) - sin - cos * pitch)
    along_z = u * q + STANDARD_GRAVITY * (np.cos(reference.pitch + pitch) - cos + sin * pitch)
    return np.column_stack((along_x, along_z, np.zeros(len(q))))


def _anchored(states: Array, manoeuvre: Manoeuvre, reference: Reference) -> Array:
    """``states`` (N, 4) with the means of u, w and the pitch that were measured: a fit with biases of its own tells
    changes alone.

    What moves across the mean flow makes the mean of the airspeed greater than the airspeed of the mean.
    """
    across = (states[:, 1] * reference.u - states[:, 0] * reference.w) / np.hypot(reference.u, reference.w)
    airspeed = manoeuvre.airspeed - float(np.var(across)) / (2 * manoeuvre.airspeed)
    share = airspeed / float(np.hypot(reference.u, reference.w)) - 1
    pitch = float(manoeuvre.raw[:, 3].mean()) - reference.pitch
    means = np.array([share * reference.u, share * reference.w, 0.0, pitch])
    moved: Array = states + np.array([1, 1, 0, 1]) * (means - states.mean(axis=0))
    return moved
