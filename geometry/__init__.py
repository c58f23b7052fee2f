"""What a machine is: frames, parts, joints, axes, poses, closed loops; numpy only. Never meshes,
finite element matrices or files.
"""
