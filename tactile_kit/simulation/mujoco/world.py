"""One world in MuJoCo: the hand and one object, advanced one control step (0.1 s) at a time.

It stands beside Bullet's world (simulation/world.py) and is used alike; docs/mujoco.md says in what they differ.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_kit.errors import EngineError
from tactile_kit.hand import kinematics
from tactile_kit.hand.controller import Impedance, ImpedanceController
from tactile_kit.rotations import to_quaternion
from tactile_kit.simulation.bodies import MIN_MASS, Body
from tactile_kit.simulation.config import SAMPLES, SimulationConfig
from tactile_kit.simulation.mujoco.scene import load_mujoco, scene
from tactile_kit.simulation.world import MAX_JOINT_SPEED, Grasp, PhysicsFault

Array = NDArray[np.float64]
PLACE = slice(kinematics.ALL_JOINTS, kinematics.ALL_JOINTS + 3)  # of the object in qpos
TURN = slice(kinematics.ALL_JOINTS + 3, kinematics.ALL_JOINTS + 7)
MOTION = slice(kinematics.ALL_JOINTS, kinematics.ALL_JOINTS + 3)  # in qvel
SPIN = slice(kinematics.ALL_JOINTS + 3, kinematics.ALL_JOINTS + 6)
COARSEST = 500  # steps a second: at longer steps the contacts' time constant is too short for MuJoCo


class MujocoWorld:
    """The hand with one object; see :class:`tactile_kit.simulation.world.World` for the use.

    An episode is repeatable to the bit, whatever came before it in the same world.

    Attributes:
        q, e: measured joint angles and control errors of the last control step, ``(6, 12)`` rad, oldest first.
        position, rotation: of the object's canonical frame, ``(3,)`` m and ``(3, 3)``, world frame.
        joints, speeds: true joint angles and speeds ``(16,)`` rad, rad/s.
        model, data: MuJoCo's own.

    Raises:
        EngineError: mujoco is not installed; a step that is too long; a picture is asked for.
    """

    def __init__(self, config: SimulationConfig, visible: bool = False) -> None:
        self._mujoco = load_mujoco()
        if visible:
            raise EngineError("engine = 'mujoco': pictures are drawn in Bullet only; allowed is 'bullet'")
        if config.steps_per_second < COARSEST:
            raise EngineError(
                f"simulation.steps_per_second = {config.steps_per_second}: allowed are multiples of 60 from "
                f"{COARSEST} on in MuJoCo"
            )
        self.config = config
        self.q, self.e = np.zeros((SAMPLES, kinematics.JOINTS)), np.zeros((SAMPLES, kinematics.JOINTS))
        self.position, self.rotation = np.zeros(3), np.eye(3)
        self.joints, self.speeds = np.zeros(kinematics.ALL_JOINTS), np.zeros(kinematics.ALL_JOINTS)
        self.body: Body  # set by load, as the rest
        self.model: Any = None
        self.data: Any = None

    def close(self) -> None:
        """Free the model."""
        self.model = self.data = None

    def load(self, body: Body, physics: Mapping[str, Any]) -> None:
        """Bring in ``body`` and the episode's ``physics`` (names and units: ``randomization``)."""
        self.body, self.physics = body, dict(physics)
        settings = self.config
        self.model = model = copy.copy(
            scene(body.thing, body.mass, settings.filter_time_constant, settings.steps_per_second)
        )
        impedance = Impedance(physics["kp"], physics["kd"], physics["series_stiffness"])
        self._drive(impedance, np.asarray(physics["stick_friction"]))
        self._touch(physics)
        self._object = model.nbody - 1
        share = max(body.mass + float(physics["object_mass_offset"]), MIN_MASS) / body.mass
        model.body_mass[self._object] *= share
        model.body_inertia[self._object] *= share
        self.data = self._mujoco.MjData(model)
        self._mujoco.mj_setConst(model, self.data)
        # of it only the series spring is used, for what the motor's side measures
        self.controller = ImpedanceController(impedance, settings.time_step, physics["gravity"])
        self._offset = np.asarray(physics["joint_offset"], dtype=np.float64)
        self.set_gravity(float(physics["gravity"]))

    def _drive(self, impedance: Impedance, stick: Array) -> None:
        """The controller's gains and the joints' dry friction ``(12,)`` Nm."""
        model, driven = self.model, kinematics.DRIVEN_INDEX
        stiffness = impedance.stiffness * impedance.ratio
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1] = stiffness, -stiffness
        model.dof_damping[driven] = impedance.damping * impedance.ratio
        model.dof_frictionloss[driven] = stick

    def _touch(self, physics: Mapping[str, Any]) -> None:
        """Friction of tips and links; the object's own counts for nothing beside theirs."""
        for geom in range(self.model.ngeom):
            name = self.model.body(self.model.geom_bodyid[geom]).name
            if name.endswith("_distal"):
                self.model.geom_friction[geom, :2] = physics["tip_friction"], physics["spinning_friction"]
            elif name.startswith("f"):
                self.model.geom_friction[geom, 0] = physics["link_friction"]

    def place(self, grasp: Grasp) -> None:
        """Put hand and object into ``grasp``, at rest."""
        data = self.data
        self._mujoco.mj_resetData(self.model, data)
        data.qpos[: kinematics.ALL_JOINTS] = grasp.joints
        self._put(grasp.position, grasp.rotation)
        data.act[:] = grasp.command - self._offset
        self._mujoco.mj_forward(self.model, data)
        self._read()
        self._measure(slice(None))

    def _put(self, position: Array, rotation: Array) -> None:
        x, y, z, w = to_quaternion(rotation).tolist()
        self.data.qpos[PLACE], self.data.qpos[TURN] = position, (w, x, y, z)

    def pin(self) -> Callable[[], None]:
        """Something that puts the object back to where it is now, at rest."""
        place = self.data.qpos[kinematics.ALL_JOINTS :].copy()

        def back() -> None:
            self.data.qpos[kinematics.ALL_JOINTS :] = place
            self.data.qvel[kinematics.ALL_JOINTS :] = 0.0

        return back

    def set_gravity(self, gravity: float) -> None:
        """Gravity in m/s² from now on; ends any disturbance. The fingers' weight is compensated by MuJoCo."""
        self.physics["gravity"] = gravity
        self.model.opt.gravity[:] = 0.0, 0.0, -gravity
        self.disturb(np.zeros(3), np.zeros(3))

    def disturb(self, force: Array, torque: Array) -> None:
        """Force ``(3,)`` N and torque ``(3,)`` Nm at the object's centre of mass until the next call, world frame."""
        self.data.xfrc_applied[self._object] = np.concatenate([force, torque])

    def step(self, target: Array, noise: Array | None = None) -> None:
        """Advance 0.1 s towards the target joint angles ``(12,)`` rad; ``noise`` ``(6, 12)`` is added to the angles.

        Raises:
            PhysicsFault: the state is not finite or impossibly fast.
        """
        data = self.data
        data.ctrl[:] = target - self._offset  # the encoders' offset shifts what the controller holds
        for sample in range(SAMPLES):
            self._mujoco.mj_step(self.model, data, nstep=self.config.steps_per_sample)
            self._read()
            self._measure(sample, None if noise is None else noise[sample])
        fastest = np.abs(self.speeds).max()
        if warned := [name for name, number in self._warnings() if number]:
            raise PhysicsFault(
                f"MuJoCo warns of {', '.join(warned)}"
            )  # of NaN too, after which it starts anew
        if not fastest <= MAX_JOINT_SPEED:
            raise PhysicsFault(f"joint speed {fastest:.3g} rad/s, object at {self.position}")

    def _warnings(self) -> list[tuple[str, int]]:
        kinds = self._mujoco.mjtWarning
        fatal = ("BADQPOS", "BADQVEL", "BADQACC", "BADCTRL", "CONTACTFULL", "CNSTRFULL")
        return [(name, int(self.data.warning[getattr(kinds, f"mjWARN_{name}")].number)) for name in fatal]

    @property
    def command(self) -> Array:
        """Filtered command ``(12,)`` rad."""
        return self.data.act + self._offset

    def pace(self) -> tuple[float, float]:
        """Speed (m/s) and spin (rad/s) of the object."""
        motion = self.data.qvel
        return float(np.linalg.norm(motion[MOTION])), float(np.linalg.norm(motion[SPIN]))

    def overlap(self, anew: bool = False) -> float:
        """How deep (m) a finger is inside the object, at the last physics step or found ``anew``; 0 without touch."""
        if anew:
            self._mujoco.mj_forward(self.model, self.data)
        contact = self.data.contact
        owners = self.model.geom_bodyid[contact.geom]  # (n, 2)
        touching = (owners == self._object).any(axis=1)
        return float(max(0.0, -contact.dist[touching].min())) if touching.any() else 0.0

    def _read(self) -> None:
        data = self.data
        self.joints = data.qpos[: kinematics.ALL_JOINTS].copy()
        self.speeds = data.qvel[: kinematics.ALL_JOINTS].copy()
        rotation = np.empty(9)
        self._mujoco.mju_quat2Mat(rotation, data.qpos[TURN])
        self.position, self.rotation = data.qpos[PLACE].copy(), rotation.reshape(3, 3)

    def _measure(self, sample: int | slice, noise: Array | None = None) -> None:
        joint_command, driven = self.data.act, self.joints[kinematics.DRIVEN_INDEX]
        angles = self.controller.measured(driven, joint_command) + self._offset
        if noise is not None:
            angles += noise
        self.q[sample] = angles
        self.e[sample] = joint_command + self._offset - angles
