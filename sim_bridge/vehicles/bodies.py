"""The bodies of a vehicle file as a tree: mirror images filled in, and what no vehicle can be made of refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sim_bridge.multibody.tree import Body, inertia_matrix, parents_first
from sim_bridge.vectors import Floats, rotation
from sim_bridge.vehicles.sections import BodyPart, Wing
from wingbeat.errors import InputError
from wingbeat.quaternions import quaternion_from_euler

Parts = dict[str, BodyPart]

DRIVES = {"right_wing": "right", "left_wing": "left"}
"""what a wing's drive moves, and the side that it is on"""
TAIL = ("elevator", "rudder")
MOVERS = (*DRIVES, *TAIL, "stroke")
"""values of ``moved_by`` of a joint"""


def matrix_of(angles: tuple[float, float, float]) -> Floats:
    """(3, 3) r_parent_from_body of roll, pitch, yaw in rad."""
    out = np.zeros((3, 3))
    rotation(*quaternion_from_euler(*angles), out)
    return out


def mirrored(part: BodyPart, image: BodyPart) -> BodyPart:
    """``part`` reflected in the plane of symmetry, attached as ``image``."""
    (px, py, pz), (roll, pitch, yaw), (ax, ay, az) = part.place, part.rotation, part.axis
    (cx, cy, cz), (xx, yy, zz, xy, xz, yz) = part.center, part.inertia
    # Both rudders turn the same way: not as in a mirror.
    way = -1.0 if part.moved_by == "rudder" else 1.0
    return part._replace(
        parent=image.parent,
        mirror_of=image.mirror_of,
        moved_by="left_wing" if part.moved_by == "right_wing" else part.moved_by,
        place=(px, -py, pz),
        rotation=(-roll, pitch, -yaw),
        # A turn is a pseudovector: its mirror image keeps the component across the plane.
        axis=(-ax * way, ay * way, -az * way),
        center=(cx, -cy, cz),
        inertia=(xx, yy, zz, -xy, xz, -yz),
        motion_by_rudder=-part.motion_by_rudder,
    )


def completed(bodies: Parts) -> Parts:
    """The bodies of a vehicle file with the mirror images filled in.

    Raises:
        InputError: a mirror image of a body that is not there, or is itself one, or has more keys than its parent; a
            joint moved by nothing that is known, or without an axis, or by a wing's drive that moves another.
    """
    parts: Parts = {}
    for name, part in bodies.items():
        try:
            whole = _image(bodies, part) if part.mirror_of else part
            _check_joint(whole, parts)
        except InputError as error:
            raise InputError(f"bodies.{name}.{error}") from None
        parts[name] = whole
    return parts


def _image(bodies: Parts, part: BodyPart) -> BodyPart:
    model = bodies.get(part.mirror_of)
    if model is None or model.mirror_of:
        raise InputError(f'mirror_of = "{part.mirror_of}" must be a body told in full')
    _refuse(part, ("parent", "mirror_of"), f'is not told of a mirror image: it has that of "{part.mirror_of}"')
    return mirrored(model, part)


def _refuse(part: BodyPart, but: tuple[str, ...], why: str) -> None:
    """Raise InputError if there is a key other than these (``but``)."""
    for key, default in part._field_defaults.items():
        if key not in but and getattr(part, key) != default:
            raise InputError(f"{key} {why}")


def _check_joint(part: BodyPart, others: Parts) -> None:
    mover = part.moved_by
    if mover and mover not in MOVERS:
        raise InputError(f'moved_by = "{mover}" must be one of {", ".join(MOVERS)}')
    if mover == "stroke" and len(part.motion) % 2 == 0:
        raise InputError(f"motion must be a mean and then pairs of cosine and sine, not {len(part.motion)} numbers")
    if mover and not any(part.axis):
        raise InputError(f'moved_by = "{mover}" needs an axis')
    rival = next((name for name, other in others.items() if other.moved_by == mover), "")
    if rival and mover in DRIVES:
        raise InputError(f'moved_by = "{mover}" moves "{rival}" already')


def body_tree(parts: Parts, wing: Wing) -> list[Body]:
    """The bodies as a tree, base first and each after its parent, with the wings on joints of their own.

    Args:
        parts: as `completed` has them; both bodies of ``wing`` are among them.

    Raises:
        InputError: as `sim_bridge.multibody.tree.parents_first`; a base with a joint; a wing that flaps
            about no joint, or one of the other side, of the tail or of both wings; a joint with nothing to turn.
    """
    bodies = parents_first([_body(name, part) for name, part in parts.items()])
    base = bodies[0].name
    try:
        _refuse(parts[base], ("mass", "center", "inertia"), "is not told of the base: it hangs on no joint")
    except InputError as error:
        raise InputError(f"bodies.{base}.{error}") from None
    _check_wings(wing, parts)
    _check_leaves(wing, bodies)
    return bodies


def _body(name: str, part: BodyPart) -> Body:
    return Body(
        name, part.parent, part.place, matrix_of(part.rotation), part.axis, part.mass, part.center, part.inertia
    )


def way_to_base(parts: Parts, name: str) -> Iterator[str]:
    """The body of this name and those it hangs on, one on the other, without the base."""
    while parts[name].parent:
        yield name
        name = parts[name].parent


def _check_wings(wing: Wing, parts: Parts) -> None:
    if wing.left == wing.right:
        raise InputError(f'wing.left = "{wing.left}" is the right wing already')
    right, left = (_flap_joint(parts, side, getattr(wing, side)) for side in ("right", "left"))
    if left == right:
        raise InputError(f'wing.left = "{wing.left}" hangs on the joint of "{left}", as the right wing does')
    if wing.twists and wing.membrane_mass <= 0.0:
        raise InputError(
            "wing.membrane_mass must exceed 0 kg where the membrane twists: it would follow without bound"
        )


def _flap_joint(parts: Parts, side: str, wing: str) -> str:
    """The body whose joint is nearest to the base on the way from a wing."""
    joint = ""
    for name in way_to_base(parts, wing):
        found = _side(parts, name)
        if found not in ("", side):
            raise InputError(f'wing.{side} = "{wing}" hangs on "{name}", which is of the {found}')
        joint = name if any(parts[name].axis) else joint
    if not joint:
        raise InputError(f'wing.{side} = "{wing}" flaps about no joint')
    return joint


def _side(parts: Parts, name: str) -> str:
    """Return the part of the vehicle that a body belongs to, by its joint and mirror image; empty if unknown."""
    part = parts[name]
    if part.moved_by in TAIL:
        return "tail"
    if part.moved_by in DRIVES:
        return DRIVES[part.moved_by]
    if part.mirror_of:
        return "left"
    return "right" if any(other.mirror_of == name for other in parts.values()) else ""


def _check_leaves(wing: Wing, bodies: list[Body]) -> None:
    """A joint at the end of the tree has nothing to turn but its body, and the membrane of a wing."""
    carrying = {body.parent for body in bodies}
    if wing.membrane_mass > 0.0:
        carrying |= {wing.left, wing.right}
    for body in bodies:
        length = float(np.linalg.norm(body.axis))
        if body.name in carrying or length == 0.0:
            continue
        turning = np.array(body.axis) / length
        arm = np.cross(turning, body.center)
        if turning @ inertia_matrix(body.inertia) @ turning + body.mass * (arm @ arm) <= 0.0:
            raise InputError(
                f"bodies.{body.name}.inertia: about the axis of its joint there is none, it would accelerate "
                "without bound"
            )
