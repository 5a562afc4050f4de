"""What a run, a download or a few steps tell while they last, and a run's log."""
