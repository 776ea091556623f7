"""Reproduction of the folding study of Petrik and Kyrki (IROS 2019): its figures and
claims.
"""
