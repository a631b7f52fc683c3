"""Marker clouds to poses and coordinates: a flight Vicon record of the Slow Hawk (Grauer 2011, section IV)."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.motion_capture.coordinates import fit_coordinates
from logs.identification.motion_capture.markers import MarkedBody, body_poses
from logs.identification.motion_capture.motion import generalized_speeds, low_passed
from tests.logs.identification import slow_hawk_flight as hawk
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

NOISE = 0.0013
"""m; Grauer IV.A"""
STROKES = 254
"""frames; three strokes at 5.91 Hz, 500 Hz"""


def errors(body: str, seed: int) -> tuple[float, float]:
    """Root mean square errors in m and rad per axis of one body's poses, markers low-passed as in IV.C."""
    flight = hawk.fly(3.0, 1).cut(400, 400 + STROKES)
    positions = np.stack([low_passed(track, hawk.STEP, 50.0) for track in hawk.observed(flight, NOISE, seed)[body]])
    poses = body_poses(MarkedBody(body, hawk.MARKERS[body]), positions)
    position, rotation = hawk.true_poses(flight, body)
    known = np.isfinite(poses.position[:, 0])
    assert known.mean() > 0.98
    off = np.einsum("nji,njk->nik", rotation, dcms_from_quaternions(poses.quaternion))[known]
    turn = 0.5 * np.stack([off[:, i, j] - off[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    return tuple(np.sqrt(np.mean(np.square(values))) for values in ((poses.position - position)[known], turn))


@pytest.mark.parametrize("body", hawk.MARKERS)
def test_a_body_is_found_as_well_as_the_paper_found_it(body: str) -> None:
    found = np.array([errors(body, seed) for seed in range(6)]).mean(axis=0)
    assert found[0] < 0.001
    assert found[1] < 0.0045


def test_standard_errors_are_those_of_the_noise() -> None:
    flight = hawk.fly(3.0, 1)
    poses = body_poses(MarkedBody("rudder", hawk.MARKERS["rudder"]), hawk.observed(flight, NOISE, 3)["rudder"])
    position, _ = hawk.true_poses(flight, "rudder")
    off = (poses.position - position) / np.sqrt(np.diagonal(poses.covariance, axis1=1, axis2=2)[:, :3])
    assert poses.noise == pytest.approx(NOISE, rel=0.05)
    assert np.nanstd(off, axis=0) == pytest.approx(np.ones(3), rel=0.1)


def test_a_fourth_marker_that_leaps_is_left_out_and_one_not_seen_is_done_without() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 300)
    places = np.vstack([hawk.MARKERS["rudder"], (-0.1, 0.0, 0.05)])
    position, rotation = hawk.true_poses(flight, "rudder")
    cloud = position[None] + np.einsum("nij,mj->mni", rotation, places)
    cloud += NOISE * np.random.default_rng(4).normal(size=cloud.shape)
    cloud[1, 100:140] = np.nan
    cloud[3, 200:230] += 0.05
    poses = body_poses(MarkedBody("rudder", places), cloud)
    assert not poses.used[3, 201:229].any()
    assert not poses.used[1, 100:140].any()
    assert np.nanmax(np.linalg.norm(poses.position - position, axis=1)) < 0.01
    assert np.isfinite(poses.position[201:229]).all()


def test_three_markers_of_which_one_is_wrong_give_no_pose() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 300)
    cloud = hawk.observed(flight, NOISE, 5)["rudder"]
    cloud[0, 50:80] += 0.04
    poses = body_poses(MarkedBody("rudder", hawk.MARKERS["rudder"]), cloud)
    assert np.isnan(poses.position[51:79]).all()


def test_all_markers_together_tell_the_coordinates_within_their_errors() -> None:
    flight = hawk.fly(3.0, 1)
    found = fit_coordinates(hawk.mechanism(), hawk.marked(), hawk.observed(flight, NOISE, 6))
    error = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert found.names == ("right_wing", "left_wing", "elevator", "rudder")
    assert np.std((found.angles - flight.states[:, 13:17]) / error[:, 6:], axis=0) == pytest.approx(1.0, abs=0.08)
    own = np.einsum(
        "nji,nj->ni", dcms_from_quaternions(flight.states[:, 3:7]), found.position_ned - flight.states[:, :3]
    )
    assert np.std(own / error[:, :3], axis=0) == pytest.approx(1.0, abs=0.08)
    alone = body_poses(MarkedBody("fuselage", hawk.MARKERS["fuselage"]), hawk.observed(flight, NOISE, 6)["fuselage"])
    assert error[:, 4].mean() < 0.3 * np.sqrt(alone.covariance[:, 4, 4].mean())


def test_a_joint_stands_for_the_third_marker() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 300)
    positions = hawk.observed(flight, NOISE, 7)
    positions["right_wing"][0] = np.nan
    found = fit_coordinates(hawk.mechanism(), hawk.marked(), positions)
    assert np.std(found.angles[:, 0] - flight.states[:, 13]) < 0.02
    assert np.all(found.covariance[:, 6, 6] > found.covariance[:, 7, 7])


def test_frames_in_which_a_joint_is_not_seen_are_not_told() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 300)
    positions = hawk.observed(flight, NOISE, 8)
    positions["left_wing"][:, 100:120] = np.nan
    found = fit_coordinates(hawk.mechanism(), hawk.marked(), positions)
    assert np.isnan(found.angles[100:120]).all()
    assert np.isfinite(found.angles[120:]).all()
    with pytest.raises(InputError, match="no coordinates for"):
        generalized_speeds(flight.time, found)


def test_speeds_and_rates_are_the_derivatives_of_the_motion() -> None:
    flight = hawk.fly(3.0, 1)
    found = fit_coordinates(hawk.mechanism(), hawk.marked(), hawk.observed(flight, 1e-6, 9))
    speeds = generalized_speeds(flight.time, found)
    truth = hawk.moved(flight)
    inside = slice(30, -30)
    assert np.abs(speeds.speeds - truth.speeds)[inside, :6].max() < 0.02
    assert np.std((speeds.rates - truth.rates)[inside, 2]) < 0.02 * np.std(truth.rates[:, 2])
    assert np.std((speeds.rates - truth.rates)[inside, 4]) < 0.1 * np.std(truth.rates[:, 4])


def test_a_turn_through_south_while_nothing_is_seen_makes_no_leap() -> None:
    flight = hawk.fly(3.0, 1).cut(0, 300)
    heading = np.pi + 0.6 * flight.time - 0.18
    turn = np.zeros((300, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(heading)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(heading), -np.sin(heading), 1.0
    clouds = {
        body: np.einsum("nij,mnj->mni", turn, observed) for body, observed in hawk.observed(flight, 1e-6, 9).items()
    }
    for cloud in clouds.values():
        cloud[:, 146:154] = np.nan
    speeds = generalized_speeds(flight.time, fit_coordinates(hawk.mechanism(), hawk.marked(), clouds)).speeds
    pitch_rate = hawk.moved(flight).speeds[:, 4]
    assert np.abs(speeds[30:-30, 5] - 0.6).max() < 0.2
    assert np.abs(speeds[:, 4] - pitch_rate)[30:-30].max() < 0.2


def test_what_the_markers_cannot_tell_is_refused() -> None:
    line = MarkedBody("wing", np.array([(0.0, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.6, 0.0)]))
    with pytest.raises(InputError, match="one line"):
        body_poses(line, np.zeros((3, 50, 3)))
    with pytest.raises(InputError, match="2 markers"):
        body_poses(MarkedBody("wing", line.places[:2]), np.zeros((2, 50, 3)))
    with pytest.raises(InputError, match="fewer than 20 frames"):
        body_poses(MarkedBody("rudder", hawk.MARKERS["rudder"]), np.full((3, 50, 3), np.nan))
    with pytest.raises(InputError, match="base has no markers"):
        fit_coordinates(hawk.mechanism(), {"rudder": hawk.marked()["rudder"]}, {"rudder": np.zeros((3, 50, 3))})
