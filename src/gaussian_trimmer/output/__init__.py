"""What is written to disk: results, reports and pictures."""
