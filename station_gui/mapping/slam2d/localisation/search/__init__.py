"""Every place of a map where a scan may have been made."""
