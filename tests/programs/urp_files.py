"""Programs and installations of Universal Robots, written by this test alone, and an arm model of its own."""

from __future__ import annotations

import gzip
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

NOMINAL = {
    "deltaTheta": (0.0,) * 6,
    "a": (0.0, -0.6127, -0.57155, 0.0, 0.0, 0.0),
    "d": (0.1807, 0.0, 0.0, 0.17415, 0.11985, 0.11655),
    "alpha": (1.570796327, 0.0, 0.0, 1.570796327, -1.570796327, 0.0),
}
"""The arm of a UR10e by the data sheet."""
CALIBRATED = {
    "deltaTheta": (0.00030448, -1.375075868426017, -0.27832480561602735, 1.6534024772942908, 0.00076243, -3.069e-05),
    "a": (4.15576e-05, -0.11923316071456752, 0.04723284563966942, 1.48351e-05, 9.48797e-05, -1.2739e-06),
    "d": (0.18086094, -469.05990774186796, 865.1065605066966, -395.87221185463557, 0.11998051, 0.11637143),
    "alpha": (1.570676327, 0.00128, -0.00144, 1.570724327, -1.570976327, 0.0),
}
"""The same arm as its controller was calibrated: two nearly parallel axes make long offsets that cancel."""
ANGLES = re.compile(rb'<JointAngles angles="([^"]*)"/>')


def forward(arm: dict[str, tuple[float, ...]], q: Sequence[float]) -> np.ndarray:
    """Return the flange pose (4, 4) [m]: Rz(q + deltaTheta) Tz(d) Tx(a) Rx(alpha), joint after joint."""
    tf = np.eye(4)
    for angle, offset, a, d, alpha in zip(q, arm["deltaTheta"], arm["a"], arm["d"], arm["alpha"], strict=True):
        turn, move, twist = np.eye(4), np.eye(4), np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", angle + offset).as_matrix()
        move[:3, 3] = a, 0.0, d
        twist[:3, :3] = Rotation.from_euler("x", alpha).as_matrix()
        tf = tf @ turn @ move @ twist
    return tf


def as_transform(pose: Sequence[float]) -> np.ndarray:
    tf = np.eye(4)
    tf[:3, :3], tf[:3, 3] = Rotation.from_rotvec(pose[3:]).as_matrix(), pose[:3]
    return tf


def listed(values: Sequence[float]) -> str:
    return ", ".join(repr(float(value)) for value in values)


@dataclass
class Waypoint:
    """A waypoint as the editor writes it."""

    name: str
    q: Sequence[float]
    tcp: Sequence[float] = (0.0, 0.0, 0.15, 0.0, 0.0, 0.0)
    arm: dict[str, tuple[float, ...]] = field(default_factory=lambda: NOMINAL)
    feature: Sequence[float] = (0.0,) * 6
    kind: str = "Fixed"

    def xml(self) -> str:
        status = "NOT_INITIALIZED" if self.arm is NOMINAL else "LINEARIZED"
        rows = "".join(f'\n          <{key} value="{listed(self.arm[key])}"/>' for key in self.arm)
        return f"""
    <Waypoint type="{self.kind}" name="{self.name}" kinematicsFlags="4">
      <motionParameters/>
      <position>
        <JointAngles angles="{listed(self.q)}"/>
        <TCPOffset pose="{listed(self.tcp)}"/>
        <Kinematics status="{status}" validChecksum="true">{rows}
          <jointChecksum value="-1, -1, -1, -1, -1, -1"/>
        </Kinematics>
      </position>
      <BaseToFeature pose="{listed(self.feature)}"/>
    </Waypoint>"""


def move(
    waypoints: Sequence[Waypoint | str], kind: str = "MoveL", feature: str = "Joint_0_name", more: str = ""
) -> str:
    """Return a Move node; a text among the waypoints is taken as it is."""
    inside = "".join(one if isinstance(one, str) else one.xml() for one in waypoints)
    named = (
        feature if feature.startswith("<") else f'<feature class="GeomFeatureReference" referencedName="{feature}"/>'
    )
    return f"""
  <Move motionType="{kind}" speed="0.25" acceleration="1.2" useActiveTCP="true" positionType="CartesianPose">
    {named}{more}
    <children>{inside}
    </children>
  </Move>"""


def program(
    nodes: Sequence[str], name: str = "cell", installation: str = "default", serial: str = "20195010123"
) -> str:
    inside = "".join(nodes)
    return f"""<URProgram name="{name}" installation="{installation}" directory="/programs" createdIn="5.11.1"\
 lastSavedIn="5.11.1" robotSerialNumber="{serial}" crcValue="2874659823">
 <children>
  <MainProgram runOnlyOnce="false" InitVariablesNode="false">
  <children>{inside}
  </children>
  </MainProgram>
 </children>
</URProgram>
"""


def packed(text: str, name: str = "") -> bytes:
    """Return a text as the controller packs it; its header may name the file."""
    whole = gzip.compress(text.encode(), 6, mtime=1700000000)
    return whole[:3] + b"\x08" + whole[4:10] + name.encode() + b"\0" + whole[10:] if name else whole


def installation(tcps: dict[str, Sequence[float]], active: str, features: dict[str, Sequence[float]]) -> str:
    tools = "".join(f'\n   <tcp name="{name}" offset="{listed(pose)}"/>' for name, pose in tcps.items())
    planes = "".join(f'\n  <GeomPlane name="{name}" pose="{listed(pose)}"/>' for name, pose in features.items())
    return f"""<Installation name="default" createdIn="5.11.1">
 <TCPSettings activePose="{active}">
  <availablePoses>{tools}
  </availablePoses>
 </TCPSettings>
 <GeomFeatures>{planes}
  <worldTransform><WorldtoMarshal baseAngle="0.0" tiltAngle="0.0"/></worldTransform>
 </GeomFeatures>
 <SafetySettings>[Safety Checksum]
crc = 2874659823
 </SafetySettings>
</Installation>
"""
