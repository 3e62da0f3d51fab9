"""Backups of controllers: what a folder holds, and the frames that its programs share; one module for each maker."""
