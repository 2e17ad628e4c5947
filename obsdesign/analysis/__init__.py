"""Exact facts about a plant that synthesis and verification share."""
