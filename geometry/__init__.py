"""What a machine is: frames, materials, solids, interfaces, joints, axes and poses (numpy only)."""
