"""What is measured on strips, and the files that say so."""
