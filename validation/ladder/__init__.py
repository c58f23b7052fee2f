"""The series of fidelities of Kono et al.: points, references, statements of the paper. Never other papers."""
