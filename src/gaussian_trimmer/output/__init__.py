"""What is written: results, reports and pictures."""
