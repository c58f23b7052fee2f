"""The two beams of Kono et al. by models of rising fidelity: points, references, statements of the
paper. Never the machine of the paper.
"""
