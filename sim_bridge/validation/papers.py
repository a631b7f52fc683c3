"""The table of papers: one line each."""

from __future__ import annotations

from sim_bridge.validation import gerdes, grauer, han, insect_motion, lattice, malladi, sibilski, slow_hawk, yeo
from sim_bridge.validation.row import Paper

PAPERS: dict[str, Paper] = {
    "yeo": Paper("Yeo, Atkins, Shyy 2011: measured lift of a flapping wing", yeo.CHECKS),
    "gerdes": Paper("Gerdes, Bruck, Gupta 2017: Robo Raven II", gerdes.CHECKS, gerdes.STUDIES),
    "grauer": Paper("Grauer, Ulrich, Hubbard, Pines, Humbert 2011: Slow Hawk", grauer.CHECKS + slow_hawk.CHECKS),
    "malladi": Paper("Malladi, Krashanitsa, Silin, Shkarayev 2007: Arizona 100 cm ornithopter", malladi.CHECKS),
    "han": Paper("Han et al. 2017: insect wings in forward flight", han.CHECKS),
    "lattice": Paper("Vortex lattice: XFLR5, Wagner, Theodorsen, measured lift", lattice.CHECKS, lattice.STUDIES),
    "azuma": Paper("Azuma et al. 1985: dragonfly in climbing flight", insect_motion.DRAGONFLY_CHECKS),
    "sun": Paper("Sun and Tang 2002: fruit fly in hover, harmonic motion", insect_motion.FRUIT_FLY_CHECKS),
    "sibilski": Paper("Sibilski: entomopter", sibilski.CHECKS),
}
