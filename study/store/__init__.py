"""What lies in folders: documents, stages, meshes, locks, and which code made them."""
