"""What a scan would measure in the surfaces that earlier scans saw, in whole numbers."""
