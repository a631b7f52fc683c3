"""The air that moves with the wings, against the same told by particles: motion, force, couple."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from plant_bench import MECHANISMS, Mechanism, air, joint_rates, joints, rates, scratched, slack, state, vehicle

from sim_bridge import plant_kernel as k
from sim_bridge.multibody.tree import Equations, assemble, move
from sim_bridge.multibody.wings import add_wings, wing_motion, wing_places
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats

AIRS = {
    "still": air(),
    "wind": air(wind=(4.0, -3.0, 1.5)),
    "turning": air(wind=(4.0, -3.0, 1.5))._replace(turn_x=1.5, turn_y=-2.0, turn_z=1.0),
}


class Strip(NamedTuple):
    """One section at an instant, NED from the present place of the base."""

    place: Floats
    normal: Floats
    span: Floats
    chord: Floats
    edge: Floats
    """place of the leading edge"""


class Sections(Mechanism):
    """Mid-chords and axes of all strips, left wing first, along any path of the coordinates."""

    def strips(self, q: Any) -> Strip:
        turned = self.attitude(q)
        rows: list[tuple[Any, ...]] = []
        for name, side in ((self.wing.left, -1), (self.wing.right, 1)):
            place, axes = self.frame(q, name)
            for (span, _, chord), twist in zip(self.strip_shapes, self.twists(q, name), strict=True):
                section = axes @ twist
                edge = place + axes @ np.array([0.0, side * span, 0.0])
                forward = section @ np.array([1.0, 0.0, 0.0])
                normal, out = section @ np.array([0.0, 0.0, -1.0]), section @ np.array([0.0, side, 0.0])
                rows.append((edge - 0.5 * chord * forward, normal, out, forward, edge))
        place, normal, out, forward, edge = (np.array(column) @ turned.T for column in zip(*rows, strict=True))
        return Strip(q[0:3] + place, normal, out, forward, q[0:3] + edge)

    def path(self, rates: Floats, t: float) -> tuple[Floats, Floats]:
        """Coordinates and their rates ``t`` s along a path with these rates of our speeds at its beginning."""
        second = rates.copy()
        second[:3] = self.r @ (rates[:3] + np.cross(self.y[10:13], self.y[7:10]))
        return self.q + self.qd * t + 0.5 * second * t * t, self.qd + second * t

    def jacobian(self, what: str) -> Floats:
        """(n, 3, 6 + c) of places or spans to our speeds."""
        columns = [self.rate_of(what, self.q, e) for e in np.eye(self.q.shape[0])]
        out = np.stack(columns, axis=2)
        out[:, :, :3] = out[:, :, :3] @ self.r
        return out

    def rate_of(self, what: str, q: Floats, direction: Floats) -> Floats:
        return np.imag(getattr(self.strips(q + 1j * self.STEP * direction), what)) / self.STEP

    def through_air(self, q: Floats, qd: Floats, around: k.Surroundings) -> tuple[Floats, Floats, Strip]:
        """(n, 3) velocity of mid-chords through the air and (n,) rate of pitch against it, leading edge up."""
        at, turned = self.strips(q), np.real(self.attitude(q))
        omega = turned @ np.array([around.turn_x, around.turn_y, around.turn_z])
        wind = np.array([around.wind_north, around.wind_east, around.wind_down])
        through = self.rate_of("place", q, qd) - wind - np.cross(omega, at.place - q[0:3])
        # Seen along the span of the right wing a raised leading edge turns the chord towards the normal.
        pitch = np.sum(self.rate_of("chord", q, qd) * at.normal, axis=1)
        turn = np.sum(np.cross(omega, at.chord) * at.normal, axis=1)
        return through, pitch - turn, at

    def slowed(self, rates: Floats, around: k.Surroundings) -> tuple[Floats, Floats]:
        """(n,) rates of the speed along the normal and of the pitch rate, both through the air."""
        d = 2e-4

        def speeds(t: float) -> Floats:
            through, pitch, at = self.through_air(*self.path(rates, t), around)
            return np.stack((np.sum(through * at.normal, axis=1), pitch))

        near, far = (speeds(s * d) - speeds(-s * d) for s in (1, 2))
        normal, pitch = (8 * near - far) / (12 * d)
        return normal, pitch


def resisting(plant: Plant, y: Floats, around: k.Surroundings, apparent: Floats) -> tuple[Floats, Floats]:
    """Mass matrix and load of the plant whose air has this apparent mass (2, n) and makes no loads."""
    p, s = plant.parameters, scratched(plant)
    k.set_outside(y, around, s)
    q, qd = y[joints(plant)], y[joint_rates(plant)]
    move(p.tree, q, qd, s.base, s.outside[0:3], s.tree)
    wing_motion(s.tree, p.wings, q, qd, s.outside, s.wings)
    s.wings.loads.apparent[:] = apparent
    add_wings(p.tree, s.tree, p.wings, s.wings, Equations(s.mass, s.load))
    assemble(p.tree, s.tree, s.mass, s.load)
    return np.triu(s.mass) + np.triu(s.mass, 1).T, s.load


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("around", AIRS.values(), ids=AIRS)
def test_strips_move_through_the_air_as_their_particles_do(name: str, around: k.Surroundings) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(21), speed=6.0)
    rates(plant, y, slack(), around)
    wing_places(plant.scratch.tree, plant.parameters.wings, plant.scratch.wings)
    motion, sections = plant.scratch.wings.motion, Sections(plant, y)
    through, pitch, at = sections.through_air(sections.q, sections.qd, around)
    assert motion.along == pytest.approx(np.sum(through * at.chord, axis=1))
    assert motion.down == pytest.approx(-np.sum(through * at.normal, axis=1))
    assert motion.outward == pytest.approx(np.sum(through * at.span, axis=1))
    assert motion.pitch_rate == pytest.approx(pitch)
    assert sections.r @ motion.place == pytest.approx(at.place.T)
    for ours, theirs in zip(motion.axes, (at.span, at.chord, at.normal), strict=True):
        assert sections.r @ ours == pytest.approx(theirs.T)


@pytest.mark.parametrize("name", MECHANISMS)
def test_plunging_is_what_the_joints_alone_do_to_the_leading_edge(name: str) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(22), speed=6.0)
    rates(plant, y, slack(), AIRS["turning"])
    sections, own = Sections(plant, y), np.zeros_like(y)
    own[joint_rates(plant)] = y[joint_rates(plant)]
    own[[plant.layout.rate(twist) for twist in plant.layout.twist]] = 0.0
    direction = np.concatenate((np.zeros(6), own[joint_rates(plant)]))
    edge, normal = sections.rate_of("edge", sections.q, direction), sections.strips(sections.q).normal
    assert plant.scratch.wings.motion.plunge == pytest.approx(-np.sum(edge * normal, axis=1))


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("around", AIRS.values(), ids=AIRS)
@pytest.mark.parametrize("seed", range(3))
def test_apparent_mass_resists_the_rate_of_the_speeds_through_the_air(
    name: str, around: k.Surroundings, seed: int
) -> None:
    plant, rng = Plant(vehicle(name)), np.random.default_rng(seed)
    y = state(plant, rng, speed=6.0)
    sections, n = Sections(plant, y), 2 * plant.vehicle.wing.strips
    apparent = rng.uniform(0.01, 0.1, (2, n)) * np.array([[1.0], [0.01]])
    rates = rng.normal(size=sections.q.shape[0]) * 30.0
    (wet_mass, wet_load), (dry_mass, dry_load) = (resisting(plant, y, around, a) for a in (apparent, 0.0 * apparent))
    takes = (wet_mass - dry_mass) @ rates - (wet_load - dry_load)
    normal, pitch = sections.slowed(rates, around)
    at = sections.strips(sections.q)
    along = np.einsum("nij,ni->nj", sections.jacobian("place"), at.normal)
    about = np.einsum("nij,ni->nj", sections.jacobian("chord"), at.normal)
    expected = (apparent[0] * normal) @ along + (apparent[1] * pitch) @ about
    assert np.max(np.abs(expected)) > 1.0
    assert takes == pytest.approx(expected, abs=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_apparent_mass_matrix_is_that_of_the_airs_kinetic_energy(name: str) -> None:
    plant, rng = Plant(vehicle(name)), np.random.default_rng(5)
    y, n = state(plant, rng, speed=6.0), 2 * plant.vehicle.wing.strips
    apparent = rng.uniform(0.01, 0.1, (2, n)) * np.array([[1.0], [0.01]])
    wet, dry = (resisting(plant, y, AIRS["still"], a)[0] for a in (apparent, 0.0 * apparent))
    sections = Sections(plant, y)
    through, pitch, at = sections.through_air(sections.q, sections.qd, AIRS["still"])
    energy = 0.5 * (apparent[0] @ np.sum(through * at.normal, axis=1) ** 2 + apparent[1] @ pitch**2)
    u = np.concatenate((y[7:13], y[joint_rates(plant)]))
    assert 0.5 * u @ (wet - dry) @ u == pytest.approx(energy, rel=1e-9)
    assert np.min(np.linalg.eigvalsh(wet - dry)) > -1e-12 * np.max(wet)
