"""Cost of one comparison over K_t, beside the usual tools."""
