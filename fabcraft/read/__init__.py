"""Files become meshes and images."""
