"""What we know about a part: learning, matching, scoring and judging, without touching the world. See README.md."""
