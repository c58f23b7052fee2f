"""What is known of a machine before anything is planned or computed, from rigid bodies: motions that are free, and
pictures. Never: stages.
"""
