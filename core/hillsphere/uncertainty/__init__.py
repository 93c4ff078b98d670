"""What is not known exactly: declared once, drawn by campaigns, bounded for LFTs, a covariance."""
