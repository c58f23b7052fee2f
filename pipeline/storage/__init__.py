"""Files that are whole or not there: store, keys, records, outputs, JSON. Never what a result means."""
