"""What is shown of an answer: text, tables, pictures and the report."""
