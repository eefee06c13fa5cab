//! What `adjoints` finds and accepts: each entry has its reason, and one that is no longer needed fails.

/// Adjoints of operator folders that no entry of the list runs.
pub(crate) const OFF_THE_LIST: &[(&str, &str)] = &[
    (
        "kernels/body/pose.rs squared_adjoint",
        "a copy without the constant last rows, which body.skin gives no gradient",
    ),
    ("kernels/splat/render.rs adjoint", "makes room for splat.render's adjoint_into, which the entry runs"),
];

/// Functions elsewhere that are named like adjoints and derive nothing, or only string adjoints of the list.
pub(crate) const NAMED: &[(&str, &str)] = &[
    ("train/fit/drawing.rs Workspace::adjoint", "splat.render with the buffers of the workspace"),
    ("train/fit/drawing.rs Workspace::give_back", "puts a buffer back"),
    ("train/tape/record.rs Tape::backward", "replays the adjoints that were recorded"),
    ("train/tape/record.rs Tape::backward_scalar", "replays the adjoints that were recorded"),
    ("train/tape/check/sabotage.rs Sabotaged::shipped_adjoint", "runs the operator under test"),
    ("train/tape/check/sabotage.rs Sabotaged::vjp", "runs the twin of the operator under test"),
    (
        "last/avatar/person.rs Avatar::adjoint",
        "strings body.skin, body.rest, splat.covariance, splat.activate and shade.diffuse",
    ),
    ("last/avatar/pose.rs adjoint", "puts the joints of body.pose into another order"),
    ("last/avatar/skin.rs adjoint", "strings body.skin and body.rest"),
    (
        "last/model/latent/mod.rs adjoint",
        "strings the operators of causal and loss.groups; sums what they give",
    ),
    ("last/model/latent/pieces.rs In::link_adjoint", "causal.structure in the mode of the reading"),
    ("last/model/step.rs spread", "variances of factors, no adjoint"),
    ("last/model/structure.rs StructureBar::grads", "names the gradients of parameters"),
    (
        "last/structure/mcsl.rs Net::pull_back",
        "a baseline learner that tests alone run; held to differences by its own test",
    ),
    ("cli/report/images.rs scale_bar", "a bar of colours"),
];

/// What functions elsewhere compute with cotangents: function, how the text begins (nothing: all of it),
/// reason.
pub(crate) const COMPUTING: &[(&str, &str, &str)] = &[
    ("train/tape/record.rs Bar::add", "*s+=*x", "adds contributions to one cotangent"),
    (
        "train/tape/record.rs Tape::weighted_sum",
        "g*w",
        "the tape's sum of losses with constant weights; not on the list, tested in closed form by the tape's own tests",
    ),
    (
        "train/tape/check/sabotage.rs Sabotaged::shipped_adjoint",
        "1.01*x",
        "a wrong gradient, which the checks have to find",
    ),
    (
        "train/fit/splat/pass.rs Target::compare",
        "adjoint(&pair,&l1_saved,1.0-SSIM_WEIGHT",
        "the constant weight of a loss is its cotangent",
    ),
    (
        "oracle/oracle/program.rs check_program",
        "program.calls.get()+calls_of",
        "a number of calls, for the progress of the check",
    ),
    ("last/avatar/density.rs Latent::add", "self.sums[i]+=", "statistics of gradients, for density control"),
    (
        "last/avatar/density.rs Latent::add",
        "self.views[i]+=1",
        "statistics of gradients, for density control",
    ),
    ("last/avatar/fit/pass.rs PersonFit::pass", "*to+=w*from", "adds the cotangents of two losses, weighted"),
    ("last/avatar/fit/pass.rs PersonFit::pass", "self.tally.gradients+=1", "counts"),
    ("last/avatar/view.rs Target::compare", "3*((top+r)*width+left)", "an index"),
    (
        "last/avatar/view.rs Target::compare",
        "*to+=*from",
        "adds the cotangent of a crop where it was cut: the adjoint of `cut`",
    ),
    (
        "last/model/guide.rs Trained::latent_loss",
        "let mu_bar=direct.iter().zip(&bar.eps)",
        "adds the cotangents of two paths",
    ),
    (
        "last/model/latent/mod.rs adjoint",
        "let cotangent=groups::Out{",
        "the weights of the losses are their cotangents",
    ),
    ("last/model/latent/pieces.rs In::link_adjoint", "*d+=g", "adds the cotangents of two paths"),
    (
        "last/model/step.rs graph_costs",
        "adjoint(&p,n,settings.alpha,&saved,lambda+rho*h,",
        "derivative of λh + ½ρh² by h, the cotangent of causal.acyclic",
    ),
    ("last/model/train.rs Training::advance", "sum+f64::from(*g)", "the norm of gradients"),
    ("last/model/train.rs Training::advance", "f64::from(*g)*f64::from(*g)", "the norm of gradients"),
    ("last/model/train.rs Training::advance", "*g*=factor", "limits the norm of gradients"),
    (
        "last/model/tune.rs Tuning::advance",
        "adjoint(&p,n,alpha,&saved,1.0+h,",
        "derivative of h + ½h² by h, the cotangent of causal.acyclic",
    ),
    (
        "last/structure/dagma.rs data_term",
        "",
        "a baseline learner that tests alone run; with the derivative of Loss::of",
    ),
    ("last/structure/dagma.rs fit", "", "a baseline learner that tests alone run"),
    ("last/structure/mcsl.rs Adam::step", "", "a baseline learner that tests alone run"),
    ("last/structure/mcsl.rs Net::pull_back", "", "a baseline learner that tests alone run"),
    ("last/structure/mcsl.rs fit", "", "a baseline learner that tests alone run"),
    ("last/structure/mcsl.rs train_node", "", "a baseline learner that tests alone run"),
    (
        "import/scene/character/posed.rs Face::folded",
        "share*dot(gradient,e)",
        "the slope of a height on a face, no cotangent",
    ),
];
