"""Scores of other libraries, by their formulas: of heads, relations and tails, (..., d)."""

import torch
from torch import Tensor
from torch.nn.functional import normalize, pairwise_distance


def halves(*vectors: Tensor) -> list[Tensor]:
    return [half for vector in vectors for half in vector.chunk(2, -1)]


def complex_of_libkge(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    r_re, r_im, t_re, t_im = halves(r, t)
    left, right = torch.cat((h, h), -1), torch.cat((t, t_im, t_re), -1)
    return (left * right * torch.cat((r_re, r, -r_im), -1)).sum(-1)


def rotate_of_libkge(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    h_re, h_im, t_re, t_im = halves(h, t)
    real, imaginary = h_re * r.cos() - h_im * r.sin() - t_re, h_re * r.sin() + h_im * r.cos() - t_im
    return -torch.hypot(real, imaginary).norm(p=2, dim=-1)


def complex_of_openke(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    h_re, h_im, t_re, t_im, r_re, r_im = halves(h, t, r)
    return (h_re * t_re * r_re + h_im * t_im * r_re + h_re * t_im * r_im - h_im * t_re * r_im).sum(
        -1
    )


def complex_of_ampligraph(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    h_re, h_im, r_re, r_im, t_re, t_im = halves(h, r, t)
    return (h_re * (r_re * t_re + r_im * t_im) + h_im * (r_re * t_im - r_im * t_re)).sum(-1)


def hole_of_ampligraph(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    k = h.shape[-1] // 2
    return 2 / k * complex_of_ampligraph(h, r, t)


def transe_of_openke(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    h, r, t = (normalize(vector, 2, -1) for vector in (h, r, t))
    return -torch.norm((h + r) - t, 2, -1)


def transe_of_dicee(h: Tensor, r: Tensor, t: Tensor) -> Tensor:
    return -pairwise_distance(h + r, t, p=2)
