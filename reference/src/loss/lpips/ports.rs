//! Ports of `loss.lpips`: the layers of VGG16 under the names of other programs' files.

use crate::ports::{Dtype, Port, ports};

const fn weight(name: &'static str, shape: &'static str) -> Port {
    Port::fixed(shape, "all absent: generated weights").named(name).or_absent()
}

const fn passed(shape: &'static str) -> Port {
    Port::fixed(shape, "output of max(z, 0), of x, then y")
}

const fn active(shape: &'static str) -> Port {
    Port::int(shape, Dtype::U8, "1 where an output is positive")
}

const fn pool(shape: &'static str) -> Port {
    Port::int(shape, Dtype::U8, "2·row + column of the entry taken")
}

pub(super) const INPUTS: &[Port] = &[
    Port::var("H,W,3", "usually the render, sRGB-encoded").named("x"),
    Port::var("H,W,3", "usually the input photo, sRGB-encoded").named("y"),
    weight("features.0.weight", "C11,3,3,3"),
    weight("features.0.bias", "C11"),
    weight("features.2.weight", "C12,C11,3,3"),
    weight("features.2.bias", "C12"),
    weight("features.5.weight", "C21,C12,3,3"),
    weight("features.5.bias", "C21"),
    weight("features.7.weight", "C22,C21,3,3"),
    weight("features.7.bias", "C22"),
    weight("features.10.weight", "C31,C22,3,3"),
    weight("features.10.bias", "C31"),
    weight("features.12.weight", "C32,C31,3,3"),
    weight("features.12.bias", "C32"),
    weight("features.14.weight", "C33,C32,3,3"),
    weight("features.14.bias", "C33"),
    weight("features.17.weight", "C41,C33,3,3"),
    weight("features.17.bias", "C41"),
    weight("features.19.weight", "C42,C41,3,3"),
    weight("features.19.bias", "C42"),
    weight("features.21.weight", "C43,C42,3,3"),
    weight("features.21.bias", "C43"),
    weight("features.24.weight", "C51,C43,3,3"),
    weight("features.24.bias", "C51"),
    weight("features.26.weight", "C52,C51,3,3"),
    weight("features.26.bias", "C52"),
    weight("features.28.weight", "C53,C52,3,3"),
    weight("features.28.bias", "C53"),
    weight("lin0.model.1.weight", "1,C12,1,1"),
    weight("lin1.model.1.weight", "1,C22,1,1"),
    weight("lin2.model.1.weight", "1,C33,1,1"),
    weight("lin3.model.1.weight", "1,C43,1,1"),
    weight("lin4.model.1.weight", "1,C53,1,1"),
];

pub(super) const INTERMEDIATES: &[Port] = ports![
    layers: Port::fixed("5", "the terms of the sum"),
    relu1_1: passed("2,H1,W1,C11"),
    relu1_2: passed("2,H1,W1,C12"),
    relu2_1: passed("2,H2,W2,C21"),
    relu2_2: passed("2,H2,W2,C22"),
    relu3_1: passed("2,H3,W3,C31"),
    relu3_2: passed("2,H3,W3,C32"),
    relu3_3: passed("2,H3,W3,C33"),
    relu4_1: passed("2,H4,W4,C41"),
    relu4_2: passed("2,H4,W4,C42"),
    relu4_3: passed("2,H4,W4,C43"),
    relu5_1: passed("2,H5,W5,C51"),
    relu5_2: passed("2,H5,W5,C52"),
    relu5_3: passed("2,H5,W5,C53"),
];

pub(super) const PLAN: &[Port] = ports![
    active1_1: active("2,H1,W1,C11"),
    active1_2: active("2,H1,W1,C12"),
    active2_1: active("2,H2,W2,C21"),
    active2_2: active("2,H2,W2,C22"),
    active3_1: active("2,H3,W3,C31"),
    active3_2: active("2,H3,W3,C32"),
    active3_3: active("2,H3,W3,C33"),
    active4_1: active("2,H4,W4,C41"),
    active4_2: active("2,H4,W4,C42"),
    active4_3: active("2,H4,W4,C43"),
    active5_1: active("2,H5,W5,C51"),
    active5_2: active("2,H5,W5,C52"),
    active5_3: active("2,H5,W5,C53"),
    pool1: pool("2,H2,W2,C12"),
    pool2: pool("2,H3,W3,C22"),
    pool3: pool("2,H4,W4,C33"),
    pool4: pool("2,H5,W5,C43"),
];
