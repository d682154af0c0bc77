"""What the project found, on one page: figures of the paper, its tables with ours beside them, and the report."""
