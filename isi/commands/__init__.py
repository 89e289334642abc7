"""Commands of ``isi``, a module each: ``configure`` says its arguments, ``run`` does what is asked."""
