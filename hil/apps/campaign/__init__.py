"""Campaigns: many flights of one bench under conditions that vary, and what they say together (docs/campaigns.md)."""
