"""What this machine takes for a pulse: its processor, its wake-ups, its messages."""
