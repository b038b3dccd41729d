"""Floor 4: FastAPI, the viser scene and the browser dashboard."""
