"""The paper's study again: every policy over strips and range, its figures, its verdict."""
