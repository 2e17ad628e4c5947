"""Facts about interval observers that synthesis and verification share."""
