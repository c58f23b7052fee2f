"""What a motion of the machine means: budgets, names, fields, free motions. Never its errors."""
