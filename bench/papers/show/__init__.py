"""The papers' report: its lines, tables and pictures."""
