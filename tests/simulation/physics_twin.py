"""The compiled physics once more: one environment, in double precision, as plain as possible.

Speeds are metres and radians a second here, masses are matrices, and a contact is a small object: what the kernel over
lanes says in scaled speeds and rows of a table has to come to the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactile_kit.rotations import exp, from_quaternion, to_quaternion
from tactile_kit.simulation.compiled.contacts import ERP, REACH
from tactile_kit.simulation.compiled.rows import BALLS, FINGERS, SAMPLES, SHAPES, TIP_BALLS
from tactile_kit.simulation.compiled.solver import RESIDUAL
from tactile_kit.simulation.compiled.tables import hand_tables

HAND = hand_tables()


@dataclass
class Row:
    """A direction that speeds are measured and impulses given along."""

    fingers: dict[int, np.ndarray]  # Jacobian (3,) of each finger that it moves
    thing: np.ndarray  # Jacobian (6,) of the object
    impulse: float = 0.0


@dataclass
class Contact:
    finger: int
    ball: int
    bias: float
    frame: np.ndarray  # normal and two tangents, (3, 3)
    rows: list[Row] = field(default_factory=list)


class Twin:
    """One environment of a ``Batch``, by the names of ``rows.SHAPES``; ``grid (32, 32, 32, 4)`` of its object."""

    def __init__(self, batch, environment: int) -> None:
        for name in SHAPES:
            setattr(self, name, getattr(batch.now, name)[..., environment].astype(np.float64))
        config = batch.config
        self.dt, self.per_sample = config.time_step, config.steps_per_sample
        self.keep = np.exp(-self.dt / config.filter_time_constant)
        self.iterations = min(20, config.solver_iterations)
        self.grid = batch.grids.nodes[batch.variant[environment]]

    def control_step(self) -> None:
        self.deepest = 0.0
        for sample in range(SAMPLES):
            for _ in range(self.per_sample):
                self._advance()
            error = np.clip(self.filtered - self.offset - self.q, -self.limit, self.limit)
            self.z[sample, 0] = self.q + self.give * error + self.offset + self.noise[sample]
            self.z[sample, 1] = self.filtered - self.z[sample, 0]

    def _advance(self) -> None:
        dt = self.dt
        self.R = from_quaternion(self.quaternion)
        self.inertia = self.R @ np.diag(self.moments) @ self.R.T
        self._pose()
        self._move_freely()
        contacts, pairs = self._contacts(), self._pairs()
        self._solve(contacts, pairs)
        self.memory = np.zeros_like(self.memory)
        for c in contacts:
            pushes = np.array([row.impulse for row in c.rows])
            self.memory[c.finger, c.ball] = [*(pushes[:3] @ c.frame), pushes[3]]
        q = self.q + dt * self.dq
        below, above = q < HAND.lower, q > HAND.upper
        self.dq = np.where(below, np.maximum(self.dq, 0), np.where(above, np.minimum(self.dq, 0), self.dq))
        self.q = np.clip(q, HAND.lower, HAND.upper)
        self.place = self.place + dt * self.velocity[:3]
        self.quaternion = to_quaternion(exp(dt * self.velocity[3:]) @ self.R)

    def _pose(self) -> None:
        """Axes and origins of the joints, directions of the links and centres of the spheres, by finger."""
        self.axes, self.points, self.along = (
            np.empty((4, 2, 3)), np.empty((4, 3, 3)), np.empty((4, 3, 3)),
        )  # fmt: skip
        for f in range(FINGERS):
            (x, y, z, origin), (q1, q2, q3) = HAND.bases[f], self.q[f]
            level = np.cos(q1) * x + np.sin(q1) * y
            self.axes[f] = z, np.sin(q1) * x - np.cos(q1) * y
            for link, angle in enumerate((q2, q2 + q3, q2 + 2 * q3)):
                self.along[f, link] = np.cos(angle) * level + np.sin(angle) * z
            self.points[f, 0] = origin
            for link in range(2):
                self.points[f, link + 1] = self.points[f, link] + HAND.lengths[link] * self.along[f, link]
        links = HAND.ball_link
        self.balls = self.points[:, links] + HAND.ball_at[:, None] * self.along[:, links]

    def _jacobian(self, f: int, point: np.ndarray, link: int) -> np.ndarray:
        """Velocity ``(3, 3)`` of a point of a link, a column a joint."""
        lever = point - self.points[f]
        bend = sum((np.cross(self.axes[f, 1], lever[joint]) for joint in range(1, link + 1)), np.zeros(3))
        return np.stack(
            [np.cross(self.axes[f, 0], lever[0]), np.cross(self.axes[f, 1], lever[0]), bend], axis=1
        )

    def _move_freely(self) -> None:
        dt = self.dt
        self.filtered = self.target + self.keep * (self.filtered - self.target)
        error = np.clip(self.filtered - self.offset - self.q, -self.limit, self.limit)
        torque = self.feedforward + self.stiffness * error - np.einsum("fij,fj->fi", self.damping, self.dq)
        for f in range(FINGERS):
            for link in range(3):
                centre = self.points[f, link] + HAND.centres[link] * self.along[f, link]
                torque[f] -= HAND.masses[link] * self.gravity * self._jacobian(f, centre, link)[2]
            self.dq[f] = self.dq[f] + dt * HAND.inverse_mass[f] @ torque[f]
        push = self.force.copy()
        push[2] -= self.mass * self.gravity
        spin = np.linalg.solve(self.inertia, self.torque)
        self.velocity = self.calm * (self.velocity + dt * np.concatenate([push / self.mass, spin]))

    def _look_up(self, point: np.ndarray) -> tuple[float, np.ndarray]:
        """Distance from the surface of a point in the object's frame, and the outward direction there."""
        at = (point - self.origin) * self.cells
        if not ((at >= 0) & (at < 31)).all():
            return 1.0, np.array([0.0, 0.0, 1.0])
        low = at.astype(int)
        part, values = at - low, np.zeros(4)
        for corner in np.ndindex(2, 2, 2):
            values += np.where(corner, part, 1 - part).prod() * self.grid[tuple(low + corner)]
        return values[0], values[1:] / np.linalg.norm(values[1:])

    def _contacts(self) -> list[Contact]:
        found = []
        for f, b in np.ndindex(FINGERS, BALLS):
            distance, normal = self._look_up(self.R.T @ (self.balls[f, b] - self.place))
            gap = distance - HAND.ball_radius[b]
            if gap > REACH:
                continue
            self.deepest = min(self.deepest, gap)
            n = self.R @ normal
            one = np.cross([1, 0, 0] if abs(n[0]) < 0.7 else [0, 0, 1], n)
            one /= np.linalg.norm(one)
            contact = Contact(f, b, self._bias(gap), np.stack([n, one, np.cross(n, one)]))
            point, link = self.balls[f, b] - HAND.ball_radius[b] * n, HAND.ball_link[b]
            jacobian = self._jacobian(f, point, link)
            for d in contact.frame:
                contact.rows.append(
                    Row({f: d @ jacobian}, np.concatenate([-d, -np.cross(point - self.place, d)]))
                )
            turning = np.array([self.axes[f, 0] @ n, self.axes[f, 1] @ n, (link) * (self.axes[f, 1] @ n)])
            contact.rows.append(Row({f: turning}, np.concatenate([np.zeros(3), -n])))
            kept = [*(contact.frame @ self.memory[f, b, :3]), self.memory[f, b, 3]]
            for row, impulse in zip(contact.rows, kept, strict=True):
                self._push(row, impulse if kept[0] > 0 else 0.0)
            found.append(contact)
        return found

    def _pairs(self) -> list[tuple[float, Row]]:
        found = []
        for f in range(FINGERS):
            for g in range(f + 1, FINGERS):
                apart = self.balls[f, :TIP_BALLS, None] - self.balls[g, None, :TIP_BALLS]
                distances = np.linalg.norm(apart, axis=2)
                a, b = np.unravel_index(distances.argmin(), distances.shape)
                gap = distances[a, b] - 2 * HAND.ball_radius[0]
                if gap <= REACH:
                    d, middle = apart[a, b] / distances[a, b], (self.balls[f, a] + self.balls[g, b]) / 2
                    rows = {i: s * d @ self._jacobian(i, middle, 2) for i, s in ((f, 1), (g, -1))}
                    found.append((self._bias(gap), Row(rows, np.zeros(6))))
        return found

    def _bias(self, gap: float) -> float:
        return -gap / self.dt if gap > 0 else -ERP * gap / self.dt

    def _speed(self, row: Row) -> float:
        return sum(jacobian @ self.dq[f] for f, jacobian in row.fingers.items()) + row.thing @ self.velocity

    def _answer(self, row: Row) -> tuple[dict[int, np.ndarray], np.ndarray, float]:
        """Changes of the speeds by a unit impulse, and of the speed along the row."""
        fingers = {f: HAND.inverse_mass[f] @ jacobian for f, jacobian in row.fingers.items()}
        thing = np.concatenate([row.thing[:3] / self.mass, np.linalg.solve(self.inertia, row.thing[3:])])
        own = sum(fingers[f] @ jacobian for f, jacobian in row.fingers.items()) + thing @ row.thing
        return fingers, thing, own

    def _push(self, row: Row, impulse: float) -> float:
        """Give ``row`` so much more; the change of speed along it."""
        fingers, thing, own = self._answer(row)
        for f, change in fingers.items():
            self.dq[f] = self.dq[f] + change * impulse
        self.velocity = self.velocity + thing * impulse
        row.impulse += impulse
        return abs(impulse * own)

    def _wanted(self, row: Row, speed: float = 0.0) -> float:
        """The impulse that would bring the row to ``speed``."""
        return row.impulse + (speed - self._speed(row)) / self._answer(row)[2]

    def _solve(self, contacts: list[Contact], pairs: list[tuple[float, Row]]) -> None:
        rubbed = np.zeros((FINGERS, 3))
        for _ in range(self.iterations):
            for f, i in np.ndindex(FINGERS, 3):
                limit, before = self.stick[f, i] * self.dt, rubbed[f, i]
                rubbed[f, i] = np.clip(before - self.dq[f, i] / HAND.inverse_mass[f, i, i], -limit, limit)
                self.dq[f] = self.dq[f] + HAND.inverse_mass[f, :, i] * (rubbed[f, i] - before)
            for bias, row in pairs:
                self._push(row, max(self._wanted(row, bias), 0) - row.impulse)
            largest = 0.0
            for contact in contacts:
                normal, *tangents, turning = contact.rows
                after = max(self._wanted(normal, contact.bias), 0)
                if after == normal.impulse == 0:
                    continue
                errors = [self._push(normal, after - normal.impulse)]
                tip = contact.ball < TIP_BALLS
                bound = after * (self.tip_friction if tip else self.link_friction)
                wanted = np.array([self._wanted(row) for row in tangents])
                wanted *= min(1.0, bound / max(np.linalg.norm(wanted), 1e-30))
                errors += [self._push(row, w - row.impulse) for row, w in zip(tangents, wanted, strict=True)]
                largest = max(largest, *errors)
                if tip:
                    bound = after * self.spin_friction
                    self._push(turning, np.clip(self._wanted(turning), -bound, bound) - turning.impulse)
            if largest < RESIDUAL:
                break
