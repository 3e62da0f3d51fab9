"""Meshes of an arm: a dropped URDF folder or .zip instead of the shells that the chain gives."""

from __future__ import annotations

from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Query, Request
from starlette.responses import FileResponse

from truepose.web.meshes.index import ArmMeshes
from truepose.web.meshes.store import MeshStore
from truepose.web.multipart import FORM, received
from truepose.web.workspace import InCell, InWorkspace

router = APIRouter(tags=["meshes"])


@router.get("/cells/{cell}/meshes")
def meshes(workspace: InWorkspace, cell: InCell) -> ArmMeshes:
    """Return the meshes of a cell's arm; without a hash there are none."""
    return MeshStore(workspace).of(cell)


@router.post("/cells/{cell}/meshes", status_code=201, openapi_extra=FORM)
async def upload_meshes(request: Request, workspace: InWorkspace, cell: InCell) -> ArmMeshes:
    """Show the meshes of a URDF folder or .zip; they are reduced, and kept in the workspace."""
    store = MeshStore(workspace)
    async with received(request, store.folder) as upload:
        return await to_thread.run_sync(store.keep, cell, upload)


@router.get(
    "/cells/{cell}/meshes.bin",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)
def mesh_data(
    workspace: InWorkspace,
    cell: InCell,
    version: Annotated[str | None, Query(description="the hash, so that a browser keeps it", max_length=64)] = None,
) -> FileResponse:
    """Return the points of all parts (float32, mm, frame of their body), then their indices (uint32)."""
    sha, path = MeshStore(workspace).data(cell)
    kept = {"Cache-Control": "private, max-age=31536000, immutable" if version == sha else "no-cache"}
    return FileResponse(path, media_type="application/octet-stream", headers=kept)


@router.delete("/cells/{cell}/meshes", status_code=204)
def remove_meshes(workspace: InWorkspace, cell: InCell) -> None:
    """Show the shells again."""
    MeshStore(workspace).remove(cell)
