"""Integration in time: exact where linear, explicit where stories yield."""
