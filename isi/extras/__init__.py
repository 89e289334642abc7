"""What few need: readers (entry points of ``isi.sources``), the recorder of the live simulator,
and the study of entities that PyKEEN did not train.
"""
