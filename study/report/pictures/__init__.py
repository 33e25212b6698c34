"""Pictures of meshes and fields, drawn in a process of their own."""
