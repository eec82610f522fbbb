"""The next recording: a manoeuvre within limits that tells rival explanations apart."""
