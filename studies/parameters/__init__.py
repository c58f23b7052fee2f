"""`[studies.NAME]`: its points, records, tables and costs. Never poses."""
