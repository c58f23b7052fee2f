"""Values with their source, closed forms, rows of the table. Never a computation by Headstock."""
