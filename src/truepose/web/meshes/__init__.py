"""Meshes of an arm from a URDF: taken in, matched with the chain, reduced and kept."""
