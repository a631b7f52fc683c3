"""Names of turbulence levels.

Two sources use the same words. MIL-F-8785C means them for piloted aircraft; its moderate belongs to a wind of 30 kt.
Beard and McLain (Small Unmanned Aircraft, 2012, Table 4.1, after Langelaan 2007) mean what an aircraft of a few
kilograms flies in at some 50 m; theirs are named ``small_uav``.
"""

from __future__ import annotations

KNOT = 1852.0 / 3600.0
"""m/s"""
WIND_AT_20_FT = {"none": 0.0, "light": 15.0 * KNOT, "moderate": 30.0 * KNOT, "severe": 45.0 * KNOT}
"""m/s; by level of turbulence (MIL-F-8785C 3.7.3.4)"""
INTENSITIES = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "light": (6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0),
    "moderate": (9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2),
    "severe": (17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1),
}
"""ft/s; at the heights `dryden.HEIGHTS`, exceeded with a probability of 1e-2, 1e-3 and 1e-5 (MIL-F-8785C Fig. 7)"""
SMALL_UAV = {
    "small_uav_light": (200.0, 50.0, 1.06, 0.7),
    "small_uav_moderate": (200.0, 50.0, 2.12, 1.4),
}
"""m and m/s; L_u = L_v, L_w, sigma_u = sigma_v, sigma_w (Beard and McLain 2012, Table 4.1, low altitude)"""
LEVELS = (*WIND_AT_20_FT, *SMALL_UAV)
"""names of all levels"""
LEVELS_TOLD = f"{', '.join(LEVELS[:-1])} or {LEVELS[-1]}"
"""the same in words"""
