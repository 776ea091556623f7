"""The paper's study of all policies, and the training of policies."""
