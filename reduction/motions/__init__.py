"""What a motion of the machine means: compliance budgets, names of modes, motions of bodies. Never
its errors.
"""
