"""Sources of experiments: logs, tables, motion capture and benches."""
