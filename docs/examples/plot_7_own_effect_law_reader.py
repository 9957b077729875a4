"""
Your own effect, law and reader
===============================

What your lab has and bulgefit does not know is added from a package of your own, by one class or
function and one line that names it. This shows what they look like; :doc:`/own_effect` shows the
package that brings one.
"""
