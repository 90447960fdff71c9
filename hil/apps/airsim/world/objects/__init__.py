"""Objects of the scene: poses, scales, copies; lines of sight, extents, meshes and voxels of what they make up."""
