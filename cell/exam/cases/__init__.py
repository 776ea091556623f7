"""The cases of an exam: drawn by chance, sized, their keys sealed."""
