"""`unlit relight`: a saved result under other lights, as pictures and videos."""
