"""Facts about set-membership observers that synthesis and verification share."""
