"""Virtual Camera Planning (VCP), the first stage: which way is up, and where the virtual cameras stand."""
