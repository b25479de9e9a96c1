"""The durable truth: models, demonstrations, versions, aliases, jobs, sessions, stored artifacts."""
