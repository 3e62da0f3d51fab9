"""What is known of the meshes of an arm: their parts, what became of the files, and how the arms agree."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

NoteKind = Literal[
    "missing",
    "ambiguous",
    "unreadable",
    "too_large",
    "too_many",
    "link",
    "apart",
    "base_moved",
    "differs",
    "other_urdf",
]


class MeshNote(BaseModel):
    """Something to know about an upload; the pages have the sentence of each kind in three languages."""

    kind: NoteKind
    name: str = Field(description="the file, link or joint that it is about")
    detail: str = ""


class MeshPart(BaseModel):
    """Triangles of one colour on one body: a range of the points, and of the indices of the whole arm."""

    body: int = Field(description="the body: 0 is the base, i turns with joint i")
    colour: str | None = Field(description="#rrggbb; null for the neutral colour of the page")
    first_point: int
    points: int
    first_index: int
    indices: int


class JointDifference(BaseModel):
    """How far the axis of a joint lies from that of the cell's arm, all joints at zero."""

    joint: int
    distance_mm: float
    angle_deg: float


class ArmMeshes(BaseModel):
    """The meshes of a cell's arm; without a hash there are none."""

    hash: str | None = None
    urdf: str = Field("", description="the file of the arm among the uploaded ones")
    parts: list[MeshPart] = []
    placeholders: list[int] = Field([], description="bodies that keep their shell: they have no mesh, or not all of it")
    triangles: int = 0
    source_triangles: int = Field(0, description="triangles of the uploaded files")
    links: list[list[list[float]]] = Field(
        [], description="the arm that the frames of the bodies belong to: bodies of its picture, without the last one"
    )
    size: int = Field(0, description="bytes of meshes.bin: points (float32, mm, frame of the body), indices (uint32)")
    joints: list[JointDifference] = []
    notes: list[MeshNote] = []
    stale: bool = Field(False, description="the cell has got another robot since: upload again")
