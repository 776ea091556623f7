"""Configuration of a cell, its opened devices, and measurements that are spread over
processes.
"""
