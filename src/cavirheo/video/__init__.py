"""Recordings -> radius histories, and rendered recordings with a known one (`synthetic`)."""
