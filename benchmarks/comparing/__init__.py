"""What one comparison over K_t costs, beside the usual tools."""
