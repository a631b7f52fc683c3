"""What a vehicle's bodies must be: one tree, every joint with something to turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mujoco_bench import random_body
from plant_bench import vehicle

from sim_bridge.mechanism import all_parts, build_mechanism
from sim_bridge.multibody.tree import Body, build_tree
from sim_bridge.vehicles import FOLDER, load_vehicle
from sim_bridge.vehicles.sections import BodyPart, Wing
from wingbeat.errors import InputError

RAVEN = vehicle("robo_raven_ii_d")
FUSELAGE, RIGHT, LEFT, ELEVATOR = (RAVEN.bodies[name] for name in ("fuselage", "right_wing", "left_wing", "elevator"))
NOTHING = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changed", "reports"),
    [
        (
            {"right_wing": RIGHT._replace(parent="elevator"), "elevator": ELEVATOR._replace(parent="right_wing")},
            'bodies.right_wing.parent = "elevator" makes a loop: right_wing on elevator on right_wing',
        ),
        (
            {"elevator": ELEVATOR._replace(parent="elevator")},
            'bodies.elevator.parent = "elevator" makes a loop: elevator on elevator',
        ),
        ({"fuselage": FUSELAGE._replace(parent="elevator")}, 'bodies.fuselage.parent = "elevator" makes a loop'),
        (
            {"elevator": ELEVATOR._replace(parent="boom")},
            'bodies.elevator.parent = "boom" is not one of the bodies: fuselage, right_wing',
        ),
        ({"elevator": ELEVATOR._replace(parent="")}, 'bodies.elevator.parent is missing: "fuselage" is the base'),
        ({"elevator": ELEVATOR._replace(mass=0.0)}, "bodies.elevator.mass = 0 kg: a leaf without mass"),
        (
            {"elevator": ELEVATOR._replace(inertia=NOTHING * 2)},
            "bodies.elevator.inertia: about the axis of its joint",
        ),
        (
            {"elevator": ELEVATOR._replace(inertia=(1e-5, 1e-5, 3e-5, 0.0, 0.0, 0.0))},
            "bodies.elevator.inertia has principal",
        ),
        (
            {"elevator": ELEVATOR._replace(inertia=(-1e-5, 1e-5, 1e-5, 0.0, 0.0, 0.0))},
            "bodies.elevator.inertia has principal",
        ),
        ({"elevator": ELEVATOR._replace(moved_by="aileron")}, 'bodies.elevator.moved_by = "aileron" must be one of'),
        ({"elevator": ELEVATOR._replace(axis=NOTHING)}, 'bodies.elevator.moved_by = "elevator" needs an axis'),
        (
            {"elevator": ELEVATOR._replace(moved_by="right_wing")},
            'bodies.elevator.moved_by = "right_wing" moves "right_wing" already',
        ),
        ({"elevator": ELEVATOR._replace(mirror_of="left_wing")}, 'bodies.elevator.mirror_of = "left_wing" must be'),
        ({"left_wing": LEFT._replace(mirror_of="left_wing")}, 'bodies.left_wing.mirror_of = "left_wing" must be'),
        ({"left_wing": LEFT._replace(mirror_of="wing")}, 'bodies.left_wing.mirror_of = "wing" must be'),
        ({"left_wing": LEFT._replace(mass=0.1)}, "bodies.left_wing.mass is not told of a mirror image"),
        ({"fuselage": FUSELAGE._replace(axis=(1.0, 0.0, 0.0))}, "bodies.fuselage.axis is not told of the base"),
    ],
)
def test_bodies_that_make_no_tree_are_refused_in_one_line(changed: dict[str, BodyPart], reports: str) -> None:
    with pytest.raises(InputError) as refused:
        build_mechanism(RAVEN._replace(bodies=RAVEN.bodies | changed))
    assert reports in str(refused.value)
    assert str(RAVEN.path) in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("wing", "reports"),
    [
        (RAVEN.wing._replace(left="right_wing"), 'wing.left = "right_wing" is the right wing already'),
        (RAVEN.wing._replace(membrane_mass=0.0), "wing.membrane_mass must exceed 0 kg"),
        (RAVEN.wing._replace(right="fuselage"), 'wing.right = "fuselage" flaps about no joint'),
        (RAVEN.wing._replace(right="elevator"), 'wing.right = "elevator" hangs on "elevator", which is of the tail'),
        (
            RAVEN.wing._replace(right="left_wing", left="right_wing"),
            'wing.right = "left_wing" hangs on "left_wing", which is of the left',
        ),
        (RAVEN.wing._replace(right="third_wing"), 'wing.right = "third_wing" is not one of the bodies: fuselage, '),
    ],
)
def test_wings_that_could_not_fly_are_refused(wing: Wing, reports: str) -> None:
    with pytest.raises(InputError, match=reports):
        build_mechanism(RAVEN._replace(wing=wing))


def test_a_body_told_twice_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    bodies = [random_body(rng, *names, False) for names in (("a", ""), ("b", "a"), ("b", "a"))]
    with pytest.raises(InputError, match='body "b" is there twice'):
        build_tree(bodies)
    path = tmp_path / "bird.toml"
    text = (FOLDER / "robo_raven_ii_d.toml").read_text(encoding="utf-8")
    path.write_text(text + '\n[bodies.elevator]\nparent = "fuselage"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"bird\.toml: not valid TOML.*elevator") as refused:
        load_vehicle(str(path))
    assert "\n" not in str(refused.value)


def test_the_loop_is_named_although_others_hang_on_it() -> None:
    rng = np.random.default_rng(2)
    names = ("base", ""), ("feather", "wing"), ("wing", "rod"), ("rod", "wing")
    with pytest.raises(InputError, match=r'bodies\.wing\.parent = "rod" makes a loop: wing on rod on wing'):
        build_tree([random_body(rng, *pair, False) for pair in names])


def test_a_tree_is_the_same_in_whatever_order_it_is_told() -> None:
    rng = np.random.default_rng(3)
    names = ("base", ""), ("boom", "base"), ("elevator", "boom"), ("rudder", "elevator")
    bodies: list[Body] = [random_body(rng, *pair, pair[0] == "boom") for pair in names]
    for order in ([0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1]):
        tree, coordinates = build_tree([bodies[i] for i in order])
        assert coordinates == ["elevator", "rudder"]
        assert tree.parent.tolist() == [-1, 0, 1, 2]
        assert tree.coordinate.tolist() == [-1, -1, 0, 1]
        assert tree.mass.tolist() == [body.mass for body in bodies]


def test_mirror_images_of_rudders_turn_the_same_way_and_of_wings_as_in_a_mirror() -> None:
    rudder = RAVEN.bodies["rudder"]._replace(place=(-0.4, 0.1, 0.0))
    twin = BodyPart(parent="fuselage", mirror_of="rudder")
    parts = all_parts(RAVEN._replace(bodies=RAVEN.bodies | {"rudder": rudder, "twin": twin}))
    assert parts["twin"].axis == parts["rudder"].axis and parts["twin"].place == (-0.4, -0.1, 0.0)
    assert parts["twin"].moved_by == "rudder"
    assert parts["left_wing"].axis == (1.0, 0.0, 0.0) and parts["left_wing"].moved_by == "left_wing"


def test_a_wing_that_cannot_flap_is_refused() -> None:
    vehicle = load_vehicle("robo_raven_ii_d")
    stiff = {
        name: part._replace(axis=(0.0, 0.0, 0.0), moved_by="", damping=0.0) for name, part in vehicle.bodies.items()
    }
    stiff |= {name: part for name, part in vehicle.bodies.items() if part.mirror_of or not part.parent}
    with pytest.raises(InputError, match=r'wing\.right = "right_wing" flaps about no joint'):
        build_mechanism(vehicle._replace(bodies=stiff))
