"""The field's mathematics; knows no plant and imports nothing of ours."""
