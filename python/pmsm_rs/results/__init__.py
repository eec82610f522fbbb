"""What answers hold: values over the JSON, their words, tables and traces."""
