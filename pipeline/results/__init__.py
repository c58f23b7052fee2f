"""What a run found: types, summary, results.h5, views, mode files. Never computing it."""
