"""Export for the table-driven unit: writer and templates."""
